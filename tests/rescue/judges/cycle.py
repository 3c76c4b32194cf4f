import sys,collections,math
from statistics import median,mean
S=[];G=[];D=[];R=[];V=[];N=[]
by=collections.defaultdict(list)
for l in open(sys.argv[1]):
    w=l.split(None,3)
    if w and w[0] in 'EP': by[w[1]].append(l)
for k,ls in by.items():
    mode=None;t0=None;pos=None;n=0;start=None
    last=None
    for l in ls:
        w=l.split(None,4)
        t=float(w[2])
        if w[0]=='P':
            x,y,h=map(float,l.split()[3:6])
            if last and mode=='s' and t-t0>2:
                dh=(h-last[3]+math.pi)%(2*math.pi)-math.pi
                dd=math.hypot(x-last[1],y-last[2])
                if dd<0.01: R.append(abs(dh)/(t-last[0]))
            if last and mode=='g':
                dd=math.hypot(x-last[1],y-last[2])
                dist+=dd
                V.append(dd/(t-last[0]))
            last=(t,x,y,h)
        elif w[3]=='Heard' and 'Engine(Dock)' in l:
            if mode=='g': G.append(t-t0);D.append(dist)
            mode='s';t0=t;n+=1
        elif 'may drive for' in l:
            if mode=='s': S.append(t-t0)
            mode='g';t0=t;dist=0
    N.append(n)
def q(a): 
    a=sorted(a); return 'n=%d mean %.2f p10 %.2f med %.2f p90 %.2f'%(len(a),mean(a),a[len(a)//10],a[len(a)//2],a[len(a)*9//10])
print('search s',q(S));print('grant s',q(G));print('grant m',q(D));print('search rate rad/s',q(R))
print('speed in grants',q(V), 'moving',q([v for v in V if v>0.05]));print('searches',q(N))
