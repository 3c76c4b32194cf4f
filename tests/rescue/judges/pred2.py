from pred import *
import pickle
def load(fn):
    # as data, but with the earlier search places (believed) per record
    import re,collections
    by=collections.defaultdict(list);Y={}
    for l in open(fn):
        w=l.split(None,3)
        if w and w[0]=='Y': Y[w[1]]=l
        elif w and w[0] in 'EP': by[w[1]].append(l)
    out=[]
    for k,ls in by.items():
        W,D,segs,_=g['geo'](Y[k]);have=set();pos=None;cur=None;how=None;new=None;n=0;tr=[]
        for l in ls:
            w=l.split(None,4)
            if w[0]=='P': pos=tuple(map(float,l.split()[3:5]));continue
            if w[3]=='Heard' and 'Engine(Dock)' in l and pos:
                s=g['seen'](pos,segs,W,D);new=len(s-have)*.0625;have|=s
            elif w[3]=='Log':
                if ' R end' in l: how=l.split(' R end')[1]; endp=tuple(map(float,how.split()[:2]))
                if ' B ' in l:
                    t=l.split();i=t.index('B');b=tuple(map(float,t[i+1:i+3]))
                    if cur and how: out.append((k,n,cur[0],cur[1],endp,new,list(tr)))
                    tr.append(b);n+=1;how=None
                    cur=({},set())
                elif ' M ' in l:
                    t=l.split()
                    for c in t[t.index('M')+1:]:
                        a=c.split(',');kk=(int(a[0]),int(a[1]));cur[0][kk]=int(a[2])/10
                        if a[3]=='1': cur[1].add(kk)
    return out
d=[]
import sys
for f in sys.argv[1:]: d+=load(f)
d=[x for x in d if x[5] is not None]
import math
T=[x[5] for x in d]
nov=[min(math.dist(x[4],q) for q in x[6]) for x in d]
P=[gain(x[2],x[3],(math.floor(x[4][0]/C),math.floor(x[4][1]/C))) for x in d]
print('novelty corr',corr(nov,T),corr(ranks(nov),ranks(T)))
for a,b in ((0,.8),(.8,1.3),(1.3,1.8),(1.8,2.5),(2.5,9)):
    for lo,hi in ((0,1),(1,2),(2,3.5),(3.5,99)):
        v=[t for t,n,p in zip(T,nov,P) if a<=n<b and lo<=p<hi]
        if v: print('nov %.1f-%.1f p %.1f-%.1f: n %3d mean %.1f vain %.2f'%(a,b,lo,hi,len(v),sum(v)/len(v),sum(t<1 for t in v)/len(v)))
print()
for name,W in [('p',P),('nov',nov),('p*nov2',[p*min(n,2) for p,n in zip(P,nov)]),('(p+.5)*nov2',[(p+.5)*min(n,2) for p,n in zip(P,nov)]),('(p+.5)*nov1.5',[(p+.5)*min(n,1.5) for p,n in zip(P,nov)]),('(p+.5)*nov3',[(p+.5)*min(n,3) for p,n in zip(P,nov)]),('(p+1)*nov2',[(p+1)*min(n,2) for p,n in zip(P,nov)]),('sat',[min(p,3)*min(n,2) for p,n in zip(P,nov)])]:
    o=sorted(zip(W,T));n=len(o)
    print('%-14s corr %.2f rank %.2f '%(name,corr(W,T),corr(ranks(W),ranks(T))),' '.join('[%.1f-%.1f: %.1f vain %.2f]'%(o[i*n//6][0],o[(i+1)*n//6-1][0],sum(t for _,t in o[i*n//6:(i+1)*n//6])/(n/6),sum(t<1 for _,t in o[i*n//6:(i+1)*n//6])/(n/6)) for i in range(6)))
P10=[gain(x[2],x[3],(math.floor(x[4][0]/C),math.floor(x[4][1]/C)),INTO=10) for x in d]
W=[(p+.5)*min(n,2) for p,n in zip(P10,nov)];print('into10',corr(W,T),corr(ranks(W),ranks(T)))
