import sys,re,math,collections,pickle
fn=sys.argv[1]
import subprocess
# geometry by geo file
subprocess.run(['python3','geo.py',fn,'/tmp/qs.geo'])
geo={};L=open('/tmp/qs.geo').read().split('\n');i=0
while i<len(L):
    if L[i].startswith('K '):
        _,k,n=L[i].split();n=int(n);geo[k]=[tuple(map(float,x.split())) for x in L[i+1:i+1+n]];i+=n+1
    else: i+=1
def cast(segs,x,y,a):
    dx,dy=math.cos(a),math.sin(a);r=99.
    for x1,y1,x2,y2 in segs:
        ex,ey=x2-x1,y2-y1;den=dx*ey-dy*ex
        if abs(den)<1e-9: continue
        t=((x1-x)*ey-(y1-y)*ex)/den;u=((x1-x)*dy-(y1-y)*dx)/den
        if t>0 and 0<=u<=1 and t<r: r=t
    return r
true={};cur={};out=[]
for l in open(fn):
    w=l.split(None,5)
    if not w: continue
    if w[0]=='P': true[w[1]]=tuple(map(float,l.split()[3:6]))
    elif w[0]=='E' and w[3]=='Log':
        t=l.split('Log',1)[1].split()
        j=next((i for i,x in enumerate(t) if x in 'BQ' and len(x)==1),None)
        if j is None: continue
        k=w[1]
        if t[j]=='B': cur[k]=dict(true=true[k],key=k,rows=[],n=len(out));out.append(cur[k])
        elif k in cur:
            for r in t[j+1:]:
                p=r.split(',')
                try: cur[k]['rows'].append((float(p[0]),float(p[1]),p[2],[tuple(map(float,x.split(':'))) for x in p[3:]]))
                except ValueError: pass
print(len(out),collections.Counter(len(o['rows'])//10*10 for o in out))
for o in out:
    x,y,h=o['true']
    o['td']=[cast(geo[o['key']],x,y,h+r[0]) for r in o['rows']]
pickle.dump(out,open('/tmp/qs.pkl','wb'))
